"""Models the twin with the platform's own effects, so that the platform's simulator can run it.

The twin's generator (`wearscope.demonstration.twin`) shares no code with these effects, so that it is an
independent reference. A test compares the torques of both.
"""
