from ._columns import Column as Column
from ._contents import parameters_in as parameters_in
from ._log import Log as Log
from ._read import read_log as read_log
from ._robots.read import read_robot_log as read_robot_log
from ._written import PWM as PWM
from ._written import Written as Written
