"""`dlo_sim study stability`: stability limits and energy errors of the methods, extreme cables."""
