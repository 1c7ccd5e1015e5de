"""Numbers of a real cable from recordings of its motion."""
