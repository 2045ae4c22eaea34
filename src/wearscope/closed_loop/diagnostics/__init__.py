"""What is looked at beside the verdict."""
