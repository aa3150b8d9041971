"""What a craft measures with, each with its readings as vehicles log them: one per file.

A new sensor is one class with `registered` in a file of its own, and its line here.
"""

from diffthrust.models._craft.kinematics import Kinematics as Kinematics
from diffthrust.models._craft.sensor import SENSORS as SENSORS
from diffthrust.models._craft.sensor import Sensor as Sensor
from diffthrust.sensors._attitude import Attitude as Attitude
from diffthrust.sensors._dvl import DVL as DVL
from diffthrust.sensors._gnss import GNSS as GNSS
from diffthrust.sensors._imu import IMU as IMU
from diffthrust.sensors._pressure import Pressure as Pressure
