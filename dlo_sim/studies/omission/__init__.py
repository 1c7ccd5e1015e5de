"""What leaving a term out saves, and what it costs."""
