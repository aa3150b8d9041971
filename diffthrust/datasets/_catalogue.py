"""All data sets by name."""

from __future__ import annotations

from pathlib import Path

from diffthrust._support.errors import InputError
from diffthrust._support.names import listing, nearest
from diffthrust.datasets._blueboat import BLUEBOAT
from diffthrust.datasets._emps import EMPS
from diffthrust.datasets._esso_osaka import ESSO_OSAKA
from diffthrust.datasets._fetch import DataSet, located
from diffthrust.datasets._ngs_thruster import NGS_THRUSTER
from diffthrust.datasets._t200 import T200


def list() -> tuple[DataSet, ...]:
    """Every data set, with its licence, citation, files and known defects.

    Example:
        >>> [about.name for about in dft.datasets.list()]
        ['ngs_thruster', 'blueboat', 'esso_osaka', 't200', 'emps']
    """
    return NGS_THRUSTER, BLUEBOAT, ESSO_OSAKA, T200, EMPS


def fetch(name: str) -> Path:
    """Download every file of a data set, and verify its checksum.

    Args:
        name: the name of a data set.

    Returns:
        The folder of its files.

    Raises:
        InputError: there is no such set, or a file is missing, cannot be downloaded or has changed.

    Example:
        >>> try:
        ...     dft.datasets.fetch("emp")
        ... except dft.InputError as error:
        ...     print(error.mend)
        Choose one of 'ngs_thruster', 'blueboat', 'esso_osaka', 't200', 'emps'.
    """
    sets = {about.name: about for about in list()}
    if name not in sets:
        raise InputError(
            f"expected the name of a data set, found {name!r}{nearest(str(name), sets, '; ')}.",
            f"Choose one of {listing(sets)}.",
        )
    return next(iter(located(sets[name]).values())).parent
