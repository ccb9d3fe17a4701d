"""One judge for motions: limits of joints, speed, torque and power, and collisions."""
