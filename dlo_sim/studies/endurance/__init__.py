"""What a sceptical user runs before the node is trusted."""
