"""What a step costs as the cable gets finer, what it keeps, how near it comes to the bound."""
