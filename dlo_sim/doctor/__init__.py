"""Looks at what a user has, and says what to mend."""
