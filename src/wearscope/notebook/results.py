"""Results as a notebook shows them: a short text, a table with units, and plots on axes of one's own."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from wearscope.errors import InputError
from wearscope.reporting.labels import effect_name, parameter_name, unit_text
from wearscope.reporting.style import PALETTE, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from wearscope.closed_loop.diagnosis import Diagnosis
    from wearscope.detection.judgement import Detection
    from wearscope.notebook.model_errors import ModelErrors


#: Unit of a column whose rows have units of their own.
OWN_UNIT = "as the column unit says"


def with_units(table: pd.DataFrame, units: Mapping[str, str]) -> pd.DataFrame:
    """Table whose ``attrs["units"]`` has the unit of each column that has one."""
    table.attrs["units"] = {name: unit for name, unit in units.items() if name in table.columns}
    return table


def take_axes(ax: "Axes | None", width: float = 7.0, height: float = 4.0) -> "Axes":
    """The caller's axes, or new ones."""
    return new_figure(width, height).subplots() if ax is None else ax


class Shown:
    """What a notebook shows of a result: its headline, then `summary`."""

    def headline(self) -> str:
        """The answer in a sentence."""
        raise NotImplementedError

    def summary(self) -> pd.DataFrame:
        """The answer as a table with units."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"{type(self).__name__}: {self.headline()}"

    def _repr_html_(self) -> str:
        from markupsafe import escape

        return f"<p><strong>{escape(self.headline())}</strong></p>{self.summary().to_html(index=False)}"


@dataclass(frozen=True, repr=False)
class DiagnosisResult(Shown):
    """What `wearscope.diagnose` found.

    Attributes
    ----------
    outcome : Diagnosis
        All of it; its attributes are those of the result, too.
    """

    outcome: "Diagnosis"

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "outcome":
            raise AttributeError(name)
        return getattr(self.outcome, name)

    def headline(self) -> str:
        """What the model lacks, by joint."""
        named = [f"{effect_name(one['effect'])} at {one['joint']}" for one in self.outcome.verdict["verdict"]]
        return f"the model lacks {', '.join(named)}" if named else "nothing is found that the model lacks"

    def summary(self) -> pd.DataFrame:
        """A row a named effect: joint, effect, status, equivalents, share of the error that it removes."""
        return with_units(self.outcome.summary(), {"error_reduction": "1"})

    def parameters(self) -> pd.DataFrame:
        """A row a parameter that was named: value with its 95 % interval, and the unit."""
        rows = [
            (one["joint"], one["effect"], name, value["value"], *value["ci95"], value["unit"], one["status"])
            for one in self.outcome.verdict["verdict"]
            for name, value in one["parameters"].items()
        ]
        names = ["joint", "effect", "parameter", "value", "low", "high", "unit", "status"]
        return with_units(pd.DataFrame(rows, columns=names), dict.fromkeys(names[3:6], OWN_UNIT))

    def errors(self) -> pd.DataFrame:
        """A row a joint: prediction error (RMS) before and after, noise floor, and what is left."""
        names = ["rms_before", "rms_after", "noise_floor", "unit", "state", "error"]
        joints = self.outcome.verdict["joints"]
        rows = [{"joint": joint, **{name: one.get(name) for name in names}} for joint, one in joints.items()]
        return with_units(pd.DataFrame(rows), dict.fromkeys(names[:3], OWN_UNIT))

    @cached_property
    def residuals(self) -> pd.DataFrame:
        """A row a sample: measured torque, and what the models before and after leave of it."""
        from wearscope.closed_loop.model.prediction import residual_table

        table = residual_table(self.outcome.prepared, self.outcome.predicted)
        return with_units(table, {"t": "s"})

    def plot(self, kind: str = "errors", joint: str | None = None, ax: "Axes | None" = None) -> "Axes":
        """Draw the errors by joint, or a joint's residual over time.

        Parameters
        ----------
        kind : {"errors", "residual"}
        joint : str, optional
            Of the residual; the one whose error shrank most where left out.
        ax : matplotlib axes, optional
            New ones where left out.

        Returns
        -------
        matplotlib axes

        Raises
        ------
        InputError
            Where there is no such plot or joint.
        """
        if kind not in ("errors", "residual"):
            raise InputError(f"plot: there is no '{kind}'; choose errors or residual.")
        errors = self.errors()
        if joint is not None and joint not in set(errors["joint"]):
            raise InputError(f"plot: there is no joint '{joint}'; there are {', '.join(errors['joint'])}.")
        ax = take_axes(ax)
        if kind == "errors":
            place = np.arange(len(errors))
            for k, (name, tint) in enumerate((("before", PALETTE[1]), ("after", PALETTE[0]))):
                ax.barh(place + 0.2 - 0.4 * k, errors[f"rms_{name}"], 0.4, label=name, color=tint)
            ax.set_yticks(place, errors["joint"])
            ax.set_xlabel(f"error of the torque, RMS [{errors['unit'].iloc[0]}]")
        else:
            gain = errors.set_index("joint")["rms_before"] - errors.set_index("joint")["rms_after"]
            joint = joint or str(gain.idxmax())
            rows = self.residuals[self.residuals["joint"] == joint]
            for name, tint in (("before", PALETTE[1]), ("after", PALETTE[0])):
                ax.plot(np.arange(len(rows)), rows[f"residual_{name}"], color=tint, lw=0.7, label=name)
            ax.set_xlabel("sample, all runs")
            ax.set_ylabel(f"residual at {joint} [{errors.set_index('joint').at[joint, 'unit']}]")
        ax.legend()
        return ax


@dataclass(frozen=True, repr=False)
class TrackingResult(Shown):
    """What `wearscope.track` found.

    Attributes
    ----------
    content : dict
        Of ``tracking.json``.
    changes : DataFrame
        Of ``changes.parquet``.
    """

    content: Mapping[str, Any]
    changes: pd.DataFrame

    def headline(self) -> str:
        """The changes of the last session that shows any."""
        rows = self.summary()
        if rows.empty:
            return f"no change in {', '.join(one['session'] for one in self.content['sessions'])}"
        last = rows[rows["session"] == rows["session"].iloc[-1]]
        told = [f"{effect_name(one.effect)} at {one.joint} by {one.change:+.3g} {unit_text(one.unit)}"
                for one in last.itertuples()]  # fmt: skip
        return f"session {last['session'].iloc[0]}: {', '.join(one.strip() for one in told)}"

    def summary(self) -> pd.DataFrame:
        """A row a session and change, with its 95 % interval and the session since which it counts."""
        names = ["session", "joint", "effect", "parameter", "change", "low", "high", "unit", "since"]
        rows = [
            (session["session"], *(one[name] for name in names[1:5]), *one["ci95"], one["unit"], one["since"])
            for session in self.content["sessions"]
            for one in session["changes"]
        ]
        return with_units(pd.DataFrame(rows, columns=names), dict.fromkeys(names[4:7], OWN_UNIT))

    def plot(self, joint: str | None = None, ax: "Axes | None" = None) -> "Axes":
        """Draw the changes of a joint over the sessions, with their 95 % intervals.

        Parameters
        ----------
        joint : str, optional
            The one that changed last, or the first, where left out.
        ax : matplotlib axes, optional

        Returns
        -------
        matplotlib axes

        Raises
        ------
        InputError
            Where there is no such joint.
        """
        known = list(dict.fromkeys(self.changes["joint"]))
        changed = list(self.summary()["joint"])
        joint = joint or (changed or known)[-1 if changed else 0]
        if joint not in known:
            raise InputError(f"plot: there is no joint '{joint}'; there are {', '.join(known)}.")
        rows = self.changes[self.changes["joint"] == joint]
        sessions = list(dict.fromkeys(self.changes["session"]))
        ax = take_axes(ax)
        groups = rows.groupby(["effect", "parameter", "unit"], sort=False)
        for k, ((effect, name, unit), own) in enumerate(groups):
            place = [sessions.index(one) for one in own["session"]]
            sides = np.abs(own[["change_low", "change_high"]].to_numpy().T - own["change"].to_numpy())
            label = f"{effect_name(effect)}, {parameter_name(name)} [{unit_text(unit)}]"
            ax.errorbar(place, own["change"], sides, fmt="o-", color=PALETTE[k % len(PALETTE)], label=label)
        ax.axhline(0.0, color="0.6", lw=0.8)
        ax.set_xticks(range(len(sessions)), sessions, rotation=30)
        ax.set_ylabel(f"change at {joint}")
        ax.legend(fontsize="small")
        return ax


@dataclass(frozen=True, repr=False)
class DetectionResult(Shown):
    """What `wearscope.detect` found; ``outcome`` has all of it."""

    outcome: "Detection"

    def headline(self) -> str:
        """In how many recordings which verdict was given."""
        counts = self.outcome.detection["verdict"].value_counts()
        return ", ".join(f"{verdict}: {count}" for verdict, count in counts.items()) or "nothing was judged"

    def summary(self) -> pd.DataFrame:
        """A row a recording, joint and detector that was judged: value, threshold, verdict, wear."""
        names = [
            *("run", "session", "joint", "fda", "y", "threshold", "unit", "verdict"),
            *("wear", "wear_low", "wear_high"),
        ]
        table = self.outcome.detection
        table = table.loc[table["kind"] == "judged", names].reset_index(drop=True)
        return with_units(table, {"y": OWN_UNIT, "threshold": OWN_UNIT})

    def plot(self, detector: str | None = None, ax: "Axes | None" = None) -> "Axes":
        """Draw each recording's test quantity over its threshold: above 1 is an alarm.

        Raises
        ------
        InputError
            Where there is no such detector.
        """
        rows = self.summary()
        known = list(dict.fromkeys(rows["fda"]))
        if detector is not None and detector not in known:
            raise InputError(f"plot: there is no detector '{detector}'; there are {', '.join(known)}.")
        rows = rows[rows["fda"] == (detector or known[0])] if known else rows
        ax = take_axes(ax)
        for k, (joint, own) in enumerate(rows.groupby("joint", sort=False)):
            ax.plot(
                own["run"], own["y"] / own["threshold"], "o", color=PALETTE[k % len(PALETTE)], label=joint
            )
        ax.axhline(1.0, color="0.3", ls="--")
        ax.set_ylabel("test quantity over threshold")
        ax.tick_params(axis="x", rotation=30)
        ax.legend(fontsize="small")
        return ax


@dataclass(frozen=True, repr=False)
class EvaluationResult(Shown):
    """What `wearscope.evaluate` found.

    Attributes
    ----------
    outcome : ModelErrors
        ``torque`` and ``rollouts``, in full.
    """

    outcome: "ModelErrors"

    def headline(self) -> str:
        """The range of the errors, and where the largest is."""
        rows = self.summary().dropna(subset=["error_percent"])
        if rows.empty:
            return "nothing could be simulated"
        worst = rows.loc[rows["error_percent"].idxmax()]
        size, judged = f"{worst['error_percent']:.2g} %", self.outcome.judged
        where = f"; judged at {judged['joints']} of {judged['of']} joints over {judged['seconds']:.3g} s"
        return f"up to {size} of the torque is not predicted, most at {worst['joint']}{where}"

    def summary(self) -> pd.DataFrame:
        """A row a joint: measured torque and error (RMS over all runs), and their ratio."""
        table = self.outcome.torque
        squares = table.assign(**{name: table[name] ** 2 for name in ("torque_rms", "error_rms")})
        means = squares.groupby(["joint", "unit"], sort=False)[["torque_rms", "error_rms"]].mean() ** 0.5
        means["error_percent"] = 100.0 * means["error_rms"] / means["torque_rms"]
        return with_units(means.reset_index(), {"error_percent": "%"})

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the error of each joint in per cent of its torque."""
        rows, ax = self.summary(), take_axes(ax)
        ax.barh(rows["joint"], rows["error_percent"], color=PALETTE[0])
        ax.set_xlabel("torque that is not predicted [%]")
        return ax
