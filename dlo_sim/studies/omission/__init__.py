"""Time saved and error made by omitting a term of the model."""
