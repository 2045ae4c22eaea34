"""A study in one file: what it holds, how it is read without trust, and how two studies differ."""
