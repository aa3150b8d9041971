"""Ready layouts of crafts, every number with its source and how far it is to be trusted.

A new layout is one file, and its line here.
"""

from diffthrust.layouts._blueboat import BLUEBOAT as BLUEBOAT
from diffthrust.layouts._bluerov2 import BLUEROV2 as BLUEROV2
from diffthrust.layouts._bluerov2 import BLUEROV2_HEAVY as BLUEROV2_HEAVY
from diffthrust.layouts._ferry import FERRY as FERRY
from diffthrust.layouts._jason_jr import JASON_JR as JASON_JR
from diffthrust.layouts._layout import MARKS as MARKS
from diffthrust.layouts._layout import Fact as Fact
from diffthrust.layouts._layout import Layout as Layout
from diffthrust.layouts._layout import layout_named as layout_named
from diffthrust.layouts._otter import OTTER as OTTER
