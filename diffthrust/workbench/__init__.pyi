from ._explore import Workbench as Workbench
from ._explore import explore as explore
from ._session import Session as Session
from ._session import Setup as Setup
from ._session import Stretch as Stretch
from ._source import Source as Source
