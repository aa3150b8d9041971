"""Layouts of crafts: ready ones with their sources, and those in the logs of autopilots.

Every number of a ready one has its source and how far it is to be trusted. A new layout
stands in `_ready.py`, and has its line here.
"""

from diffthrust.layouts._ardupilot import ARDUSUB_FRAMES as ARDUSUB_FRAMES
from diffthrust.layouts._ardupilot import ardupilot_layout as ardupilot_layout
from diffthrust.layouts._ardupilot import ardusub_mixer as ardusub_mixer
from diffthrust.layouts._in_log import layout_in as layout_in
from diffthrust.layouts._layout import MARKS as MARKS
from diffthrust.layouts._layout import CommandColumn as CommandColumn
from diffthrust.layouts._layout import Fact as Fact
from diffthrust.layouts._layout import Layout as Layout
from diffthrust.layouts._layout import RecordedLayout as RecordedLayout
from diffthrust.layouts._layout import RecordedThruster as RecordedThruster
from diffthrust.layouts._layout import layout_named as layout_named
from diffthrust.layouts._mixer import AXES as AXES
from diffthrust.layouts._mixer import Mixer as Mixer
from diffthrust.layouts._px4 import px4_layout as px4_layout
from diffthrust.layouts._px4 import px4_mixer as px4_mixer
from diffthrust.layouts._ready import BLUEBOAT as BLUEBOAT
from diffthrust.layouts._ready import BLUEROV2 as BLUEROV2
from diffthrust.layouts._ready import BLUEROV2_HEAVY as BLUEROV2_HEAVY
from diffthrust.layouts._ready import FERRY as FERRY
from diffthrust.layouts._ready import JASON_JR as JASON_JR
from diffthrust.layouts._ready import OTTER as OTTER
