from ._model import BlackBox as BlackBox
from ._polynomial import armax as armax
from ._polynomial import arx as arx
from ._polynomial import output_error as output_error
from ._select import Candidate as Candidate
from ._select import Selection as Selection
from ._select import select as select
from ._subspace import state_space as state_space
