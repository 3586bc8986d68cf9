"""Would the controller survive the actuator?"""
