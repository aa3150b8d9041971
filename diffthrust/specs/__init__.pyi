from ._spec import Spec as Spec
from ._spec import load_spec as load_spec
