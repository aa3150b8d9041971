"""Public data sets on the user's machine: whose they are, where they lie, and their logs.

    runs = dft.datasets.blueboat()
    fit = dft.fit(dft.Vessel(drive="twin"), runs.train, holdout=runs.unseen)

Each loader gives `Runs`: its ``logs`` by name, and, where there is a usual split, ``train`` and
``unseen``. `list` names the sets with licence, citation and known defects. Nothing is part of the
package: files are taken from the folder that the environment variable ``DIFFTHRUST_DATA`` names,
or downloaded once from their public repository, pinned to a commit. Their sha256 is compared at
every use: with the known one, or, where none is known beforehand, with that of the first download.
"""

from diffthrust.datasets._blueboat import blueboat as blueboat
from diffthrust.datasets._catalogue import fetch as fetch
from diffthrust.datasets._catalogue import list as list
from diffthrust.datasets._emps import emps as emps
from diffthrust.datasets._esso_osaka import esso_osaka as esso_osaka
from diffthrust.datasets._ngs_thruster import ngs_thruster as ngs_thruster
from diffthrust.datasets._record import DataFile as DataFile
from diffthrust.datasets._record import DataSet as DataSet
from diffthrust.datasets._record import Runs as Runs
from diffthrust.datasets._t200 import t200 as t200
