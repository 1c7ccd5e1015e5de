"""`dlo_sim study batch`: what running many cables at once gains."""
