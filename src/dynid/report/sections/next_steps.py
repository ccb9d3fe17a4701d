"""What to do with the result."""

from __future__ import annotations

from dynid.report.contents import ReportContents, ReportedEstimate
from dynid.report.section import Part, Section, Table

ADVICE = {
    "ill_conditioned": "Design a motion with `dynid design`, record it, identify again.",
    "low_excitation": "Move every joint, fast and slow, both ways, for 20 s or more.",
    "over_fitted": "Use fewer friction terms, or record more.",
    "not_physical": "Use it to predict torques only; `--estimator sdp` gives a consistent model.",
    "unit_suspect": "Check the units of the recording and the drive gains.",
    "saturated": "Record again with less speed or load.",
    "extrapolated": "Identify from motions as fast and as wide as those to be predicted.",
    "at_rest": "Leave standstill out with `--from` and `--to`.",
    "clock_mismatch": "Check the time column, or give `--rate`.",
}


class NextSection(Section):
    """Advice, from the verdict and the warnings."""

    anchor = "next"
    title = "What to do next"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part an estimate."""
        return tuple(_part(item, len(contents.estimates) > 1) for item in contents.estimates)


def _part(item: ReportedEstimate, named: bool) -> Part:
    codes = list(dict.fromkeys(notice.code for notice in item.warnings))
    steps = [(ADVICE[code], f"warning {code}") for code in codes if code in ADVICE]
    if item.validation is None:
        steps.insert(0, ("Predict another motion: `dynid validate`.", "nothing confirms it yet"))
    if item.level == "usable" and not steps:
        steps = [("Use it: `dynid export` writes it for other programs.", "it is confirmed")]
    return Part(
        heading=item.name if named else "",
        tables=(Table(columns=("do", "why"), rows=tuple(steps)),) if steps else (),
        words=() if steps else ("Nothing is left to do.",),
    )
