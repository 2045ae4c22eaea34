"""The numbers of the rule that accepts, ties and names: all of them, each with its unit and its reason.

The documentation lists them from here: ``docs/closed-loop-reference.md``.
"""

from pydantic import BaseModel, ConfigDict, Field


class Policy(BaseModel):
    """Numbers of the rule; written to ``verdict.json`` with the version."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    family_level: float = Field(0.005, gt=0, lt=1)
    """p-value of a term, over all candidates, shapes and joints tried with the same model, by sign flips
    of blocks, or by residual and regressors made white where the residual is autocorrelated beyond a block: a
    machine whose search ends after ten terms then has a chance of 5 % at most of a false one, before held-out
    runs are asked."""

    material_share: float = Field(0.06, ge=0, lt=1)
    """Least share of its joint's held-out loss (variance, current model) that a term must remove: less
    changes the joint's RMS error by less than 3 %, which nobody would act on."""

    material_torque: float = Field(0.001, ge=0, lt=1)
    """Least RMS of what a term gives the torque, and no other term of the model could, over that of the
    joint's torque about its mean in each run: the accuracy of filters, derivatives and of an encoder's clock
    lies below it, and none of them touches what stays the same along a run, such as a weight."""

    material_whole: float = Field(0.01, ge=0, lt=1)
    """The same of what the joint's standard model (declared and standard terms) leaves: next to a term ten
    times its size, a further one is more often the first one's form, which no machine follows exactly.
    Rotor inertia, Coulomb and viscous, which every drive has, need remove no more than this of what the model
    leaves, nor need an offset before other names are asked for."""

    material_alone: float = Field(0.025, ge=0, lt=1)
    """`material_whole` where a single run was recorded: its parts have its motion in common, along which one
    form passes for another more easily."""

    large_share: float = Field(0.1, ge=0, lt=1)
    """`material_whole` for the generic term: an effect's form may differ from its name's by as much. Plain
    friction that removes as much of its joint's loss is kept where it gains in most of the runs, whatever its
    standard error, and no drift is asked about."""

    agreeing: float = Field(0.8, ge=0, le=1)
    """Least share of the runs that inform on a term (parts of a run where there are fewer than three) that it
    predicts better when they are held out: of up to four, all. Parts of a single run must not lose more than
    their noise. Where no run does, one of three or four may lose, and plain friction, which every
    joint has, need only gain in most."""

    informing: float = Field(0.05, gt=0, lt=0.5)
    """Share of the information on a term from which a run (part) is asked whether it agrees: with less it
    gains or loses by chance. Where one recording alone has more, that one shows the term alone."""

    beyond_chance: float = Field(0.5, gt=0)
    """Share of the loss, held out and on the rows that are fitted, that is not due to chance in each of three
    runs or more: random signs, which cannot show what lies in a few blocks (a lost motion, a reversal), are
    then not asked. What explains as much is there, whether or not held-out runs agree on its form."""

    beyond_doubt: float = Field(0.7, gt=0)
    """The same in two runs, and in parts of a single one, which resemble each other more than runs do, and of
    what goes with time or temperature or is constant, as a torque that drifts is in few runs. A name that
    removes less is given up where a generic term in its place does better, and what gains less than this
    share of the best alternative is not an equivalent name."""

    fewest_blocks: float = Field(4.0, ge=0)
    """Fewest blocks, effectively, that the evidence from a single run may lie in: fewer are one event,
    which nothing repeats."""

    cancels: float = Field(12.0, gt=1)
    """Largest RMS of one column of a term over that of their sum, and of their sum over that of the joint's
    torque: beyond, columns cancel each other, or other terms. One over it is the least part of a sum larger
    than the joint's torque that other terms must not take back."""

    told_apart: float = Field(2.0, gt=0)
    """Standard errors by which a sum over held-out blocks is told from noise (as far out in Student's t):
    one in 40 of noise lies beyond."""

    material_apart: float = Field(0.02, ge=0, lt=1)
    """Least share of what the better of two terms leaves of the held-out loss by which they are told apart:
    forms that are alike except for what a reversal does differ by as much through the reversal's own form."""

    unexpected: float = Field(3.0, gt=0)
    """The same for what a joint need not have, whatever is asked of it there: rotor inertia, an offset,
    structure that cannot be added. One in 700 of noise lies beyond."""

    alike: float = Field(1.5, ge=1)
    """Factor within which two sizes of one thing are alike: errors (RMS) on the rows that are fitted of terms
    that held-out runs do not tell apart; a delay with and without a joint's reversals; the test runs' error
    and the training runs', from which a model does not carry over to other motions."""

    away: float = Field(0.2, gt=0, lt=1)
    """Share of a joint's largest speed above which it is away from its reversals, whose width is a few per
    cent of that; and of its rows that must be, so that a delay can be asked of them alone."""

    slow: float = Field(0.25, gt=0, lt=1)
    """Share of the common cut-off below which a delay must be the same: two octaves away from frequencies at
    which a position loop answers the noise of the torque, if it does below that cut-off."""

    zero_level: float = Field(0.05, gt=0, le=1)
    """p-value (Wald's test, blocks as clusters) above which a name's coefficients may all be zero: its own
    95 % interval does then not tell it from nothing."""

    set_level: float = Field(0.1, gt=0, lt=1)
    """One minus the coverage of the set of names (model confidence set)."""

    unknown_level: float = Field(0.001, gt=0, lt=1)
    """As `family_level`, for the generic term, which can be anything, and for what of a residual depends on
    the motion."""

    structure_share: float = Field(0.2, gt=0, lt=1)
    """Least share of the variance that the corrected model leaves at a joint that makes it `unexplained`,
    where it depends on the motion or on time, or differs from run to run: less is a tenth of the RMS error.
    As `material_share`, for the generic term."""

    most_terms: int = Field(8, ge=1)
    """Most named terms of a joint, standard ones not counted, and most generic ones; reaching it is said in
    the verdict."""

    flips: int = Field(999, ge=99)
    """Random sign patterns, and surrogates of a residual; the least p-value is one over them."""

    seed: int = Field(20260, ge=0)
    """Of the sign patterns and of the bootstrap of the set of names."""
