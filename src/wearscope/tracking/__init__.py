"""What changed since a machine was healthy: the reference's structure held, session by session."""
