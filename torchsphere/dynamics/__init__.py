"""SI units, kinematics and impact."""
