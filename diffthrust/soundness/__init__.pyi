from ._doubt import Doubt as Doubt
from ._doubt import Reading as Reading
from ._doubts import doubts as doubts
