"""Trial runs of settings of a scene, and the search for the fastest that is good enough."""
