"""Online estimation of the dynamic parameters, sample by sample on the controller: gradient method and recursive least
squares.

Source: (14.21)-(14.23) of Kostic, de Jager and Steinbuch, Robotics and Automation Handbook (CRC Press, 2005), ch. 14.
"""
