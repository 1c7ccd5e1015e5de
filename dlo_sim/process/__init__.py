"""The process: signals that end it, and files that are whole or absent however it ends."""
