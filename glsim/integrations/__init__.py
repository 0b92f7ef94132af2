"""Sensor noise in other programs, such as environments for robot learning."""
