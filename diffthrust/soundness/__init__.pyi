from ._doubt import Doubt as Doubt
from ._doubts import doubts as doubts
