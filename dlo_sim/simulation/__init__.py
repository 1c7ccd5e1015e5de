"""One cable that can be stepped, loaded and moved: scenes turned into arrays and loops."""
