"""An experiment file in which every key stands."""

from __future__ import annotations

FULL = """
schema: rrrgen-experiment/1
period: 2 ms
seed: 7
excitation:
  harmonics: 6
  base_frequency: 0.2 Hz
  objective: logdet
  at_rest: true
  starts: 3
  limits:
    lower: -170 deg
    upper: [170 deg, 2, 3.0]
    speed: [2*pi, 3*pi, 3*pi]
    acceleration: 60
    torque: [60, 30, 15 N*m]
    box: {z: [0.2, 900 mm]}
writing:
  text: RR
  duration: 8 s
  peak_speed: 700 mm/s
  pace: [1, 0.6]
  plane: {x: [-0.2, 0.2], y: -0.42, z: [0.4, 0.8]}
  start: [-1, -1.5, 2]
virtual_robot:
  friction:
    law: stribeck
    joints:
      - {coulomb: 3, stiction_excess: 0.5, viscous: 1, stribeck_speed: 0.1}
      - {coulomb: 1.5, viscous: 0.3, stribeck_speed: 0.1}
      - {coulomb: 0.8, viscous: 0.2, stribeck_speed: 0.1}
  encoder_resolution: 1e-5
  torque_noise: [0.1, 0.05, 20 mN*m]
  torque_record: command
control: {kind: pd, bandwidth: 5 Hz, damping: 0.9, observer: kalman}
"""
