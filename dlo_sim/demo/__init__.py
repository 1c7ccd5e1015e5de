"""The main job on input that the package makes itself: a bag, its prediction, a picture, a summary."""
