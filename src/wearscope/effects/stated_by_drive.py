"""Effects whose value the drive section of a robot's model may state.

Imported by name, so that whatever simulates a robot is seen to depend on their files.
"""

from wearscope.effects.rotor_inertia import EFFECT as ROTOR_INERTIA

#: In the order in which they are installed.
STATED_BY_DRIVE = (ROTOR_INERTIA,)
