"""`dlo_sim study stability`: how far methods go, extreme cables, random scenes."""
