"""Charts that a reader can ask: one subject a module; each takes tables and returns charts."""
