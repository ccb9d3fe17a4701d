"""Optional dependencies, loaded in one place."""

from __future__ import annotations

import importlib
import importlib.util
from types import ModuleType

from dynid.core.errors import MissingExtraError


def installed(module: str) -> bool:
    """Whether a top-level module can be imported."""
    return importlib.util.find_spec(module) is not None


def require(module: str, extra: str) -> ModuleType:
    """Import an optional module.

    Args:
        module: Dotted name of the module.
        extra: The dynid extra that installs it.

    Raises:
        MissingExtraError: The module is not installed; the message names the command.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"this needs the package '{module.split('.', 1)[0]}'",
            next_step=f"Run: pip install 'dynid[{extra}]'",
        ) from error
