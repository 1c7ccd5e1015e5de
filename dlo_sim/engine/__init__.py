"""One cable as arrays: mesh, forces, what is held, and the account of its energy."""
