"""The sections of the default report, in order: copy and change."""

from __future__ import annotations

from dynid.report.section import Section
from dynid.report.sections.comparison import ComparisonSection
from dynid.report.sections.design import DesignSection
from dynid.report.sections.friction import FrictionSection
from dynid.report.sections.next_steps import NextSection
from dynid.report.sections.parameters import ParametersSection
from dynid.report.sections.prediction import PredictionSection
from dynid.report.sections.reproduce import ReproduceSection
from dynid.report.sections.residuals import ResidualSection
from dynid.report.sections.verdict import VerdictSection


def default_sections() -> tuple[Section, ...]:
    """Verdict first, then the evidence, then how it was made."""
    return (
        VerdictSection(),
        NextSection(),
        ComparisonSection(),
        PredictionSection(),
        ParametersSection(),
        FrictionSection(),
        ResidualSection(),
        DesignSection(),
        ReproduceSection(),
    )
