"""One cable as arrays: mesh, forces, constraints of the grasps, contact, and the energy balance."""
