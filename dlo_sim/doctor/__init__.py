"""What an installation, a scene and its topics are like, each finding with what to do about it."""
