"""What is looked at in addition to the verdict."""
