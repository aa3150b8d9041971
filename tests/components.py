"""What models and effects are made of: their registry, declarations and signals."""

# ruff: noqa: F401 (tests take these names from here)

from diffthrust.models._base import (  # private: the catalogue of installed packages
    effect as effect_module,
)
from diffthrust.models._base.component import (  # private: as scripts are kept
    changed,
    file_of,
)
from diffthrust.models._base.effect import (  # private: its base is built upon
    Effect,
)
from diffthrust.models._base.made_effect import (  # private: as a formula calls them
    described_fields,
    plain_description,
)
from diffthrust.models._base.signals import (  # private: the messages alone
    elementwise,
    expect,
)
