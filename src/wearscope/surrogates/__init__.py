"""Surrogates: fitted functions from coded factors to the test quantity, with their uncertainty."""
