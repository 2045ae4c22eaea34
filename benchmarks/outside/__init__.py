"""The closed loop asked from outside: machines, motions, noise and effects written apart from the package.

Nothing here uses the package but the door that it asks, `diagnose`. Arms are the published ones, their
torque is Pinocchio's, the forms of friction and gears are not those that the package fits, and each case says
what it planted, so that a scorer can say what was found, missed and invented.
"""
