"""Whether the sessions of a data set can be tracked, before anything is identified."""

from wearscope.closed_loop.intake.plausibility import check_plausibility
from wearscope.closed_loop.intake.thinning import prepare_thinned
from wearscope.tracking.session_names import Sessions
from wearscope.tracking.session_runs import Frame, prepare_runs
from wearscope.tracking.sessions import read_reference, read_session


def check_sessions(sessions: Sessions) -> None:
    """Refuse sessions that tracking would refuse after the healthy machine is identified.

    Raises
    ------
    InputError
        Where the reference cannot be what it says, or the robot stands still in a later session.
    """
    prepared = prepare_thinned(read_reference(sessions))
    check_plausibility(prepared)
    for session in sessions.later:
        prepare_runs(read_session(sessions, session), Frame.of(prepared))
