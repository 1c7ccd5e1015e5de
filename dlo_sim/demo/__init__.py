"""The main job on input that the package makes itself: bag, prediction, picture, summary."""
