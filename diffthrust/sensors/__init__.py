"""What a craft measures with, each with its readings as vehicles log them.

A new sensor is one class with `registered` in `_sensors.py`, and its line here.
"""

from diffthrust.models._craft.kinematics import Kinematics as Kinematics
from diffthrust.models._craft.sensor import SENSORS as SENSORS
from diffthrust.models._craft.sensor import Sensor as Sensor
from diffthrust.sensors._sensors import DVL as DVL
from diffthrust.sensors._sensors import GNSS as GNSS
from diffthrust.sensors._sensors import IMU as IMU
from diffthrust.sensors._sensors import Attitude as Attitude
from diffthrust.sensors._sensors import Pressure as Pressure
