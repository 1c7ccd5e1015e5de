"""One cable as arrays: mesh, forces, constraints of the grasps, and the energy ledger."""
