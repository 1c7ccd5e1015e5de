"""One cable that can be stepped, loaded and moved: turns a scene into arrays and a time loop."""
