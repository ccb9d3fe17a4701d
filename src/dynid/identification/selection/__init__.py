"""Model selection: choices by what is left out, and what left-out errors say of a result."""

from dynid.identification.selection.assessment import (
    Assessment,
    LeftOutCells,
    ModelError,
    assess,
    assessment_from_json,
)
from dynid.identification.selection.columns import with_load
from dynid.identification.selection.gram import GramBlocks, NormalEquations, gram_blocks
from dynid.identification.selection.regions import (
    BLOCKS,
    Regions,
    TorqueInterval,
    conditions,
    find_regions,
)
from dynid.identification.selection.search import PURPOSES, Selection, select

__all__ = [
    "BLOCKS",
    "PURPOSES",
    "Assessment",
    "GramBlocks",
    "LeftOutCells",
    "ModelError",
    "NormalEquations",
    "Regions",
    "Selection",
    "TorqueInterval",
    "assess",
    "assessment_from_json",
    "conditions",
    "find_regions",
    "gram_blocks",
    "select",
    "with_load",
]
