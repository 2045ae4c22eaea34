"""The twin for the simulator; only here does the board's truth meet the platform's models and effects.

The generator next to this package shares no code with them; a test compares both.
"""
