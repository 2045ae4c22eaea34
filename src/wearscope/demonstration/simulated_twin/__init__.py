"""The twin for the simulator: the one place where the board's truth meets the platform's models and effects.

The generator next to this package shares no code with them; a test compares both.
"""
