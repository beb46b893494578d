"""Recovery: a walking robot in; the alarm, the damage and a new gait out."""
