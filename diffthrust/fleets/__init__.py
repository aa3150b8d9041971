"""All fits of a fleet at once: what differs between vehicles, what drifts, and what they share."""

from diffthrust.fleets._fleet import Fleet as Fleet
from diffthrust.fleets._fleet import fleet as fleet
from diffthrust.fleets._pooled import Pooled as Pooled
