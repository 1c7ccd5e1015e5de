"""`dlo_sim study batch`: speed-up of simulating many cables at once."""
