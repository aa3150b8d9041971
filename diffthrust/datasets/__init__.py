"""Public data sets on the user's machine: owners, files and logs.

    runs = dft.datasets.blueboat()
    fit = dft.fit(dft.Vessel(drive="twin"), runs.train, holdout=runs.unseen)

Each loader gives `Runs`: its ``logs`` by name, and, where there is a usual split, ``train`` and
``unseen``. `list` names the sets with licence, citation and known defects. Nothing is part of the
package: files are taken from the folder that the environment variable ``DIFFTHRUST_DATA`` names,
or downloaded once from their public repository, pinned to a commit. Their sha256 is compared at
every use: with the published one, or else with that of the first download.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
