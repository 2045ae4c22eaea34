"""Surrogates of the test quantity over coded factors, with their own uncertainty."""
