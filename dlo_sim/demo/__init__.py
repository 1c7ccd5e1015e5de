"""A demonstration on generated input: bag, prediction, page, picture, summary."""
