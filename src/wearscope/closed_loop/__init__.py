"""Closing the loop with measured data: residual, missing effect, correction, error before and after."""
