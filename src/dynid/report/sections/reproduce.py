"""How to make the result again."""

from __future__ import annotations

from dynid.report.contents import ReportContents, ReportedEstimate
from dynid.report.section import Part, Section, Table


class ReproduceSection(Section):
    """Settings, versions, hashes and seeds."""

    anchor = "reproduce"
    title = "How it was made"

    def parts(self, contents: ReportContents) -> tuple[Part, ...]:
        """One part an estimate, and one for files that were left out."""
        parts = [_part(item) for item in contents.estimates]
        if contents.skipped:
            table = Table(columns=("file", "why"), rows=contents.skipped)
            parts.append(Part(heading="Files left out", tables=(table,)))
        return tuple(parts)


def _part(item: ReportedEstimate) -> Part:
    made = item.estimate.provenance
    rows = [
        ("made", made.created),
        ("estimator", f"{item.estimate.estimator}, preset {item.estimate.preset}"),
        *((f"version of {name}", value) for name, value in made.versions.items()),
        *((f"input {name}", f"SHA-256 {value}") for name, value in made.inputs.items()),
        *(
            (f"setting {name}", str(value))
            for name, value in made.settings.items()
            if value not in (None, "")
        ),
        *((("seed", str(made.seed)),) if made.seed is not None else ()),
    ]
    choices = tuple((choice,) for choice in item.estimate.choices)
    tables = [Table(columns=("", ""), rows=tuple(rows))]
    if choices:
        tables.append(Table(columns=("chosen by cross-validation",), rows=choices))
    return Part(heading=item.name, tables=tuple(tables))
