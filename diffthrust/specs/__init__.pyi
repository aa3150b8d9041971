from ._spec import Spec as Spec
from ._spec import load_spec as load_spec
from ._thrusters import craft_from as craft_from
