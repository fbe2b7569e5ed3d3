"""Particle filters over boxes: the colour particle filter and GMPF."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from vtrack_ros.appearance.histogram import ColourHistogram
from vtrack_ros.frame import Frame
from vtrack_ros.geometry import Box
from vtrack_ros.parameters import Parameter, ParameterTable
from vtrack_ros.trackers.base import Estimate, Tracker, TrackState

_SHARED = ParameterTable([
    Parameter('particles', 150, 'Number of particles.', 2, 5000),
    Parameter('sigma', 0.12, 'Width of the colour likelihood exp(-(1 - rho) / (2 sigma^2)).',
              0.01, 1.0),
    Parameter('position_noise', 0.10, 'Random step of the centre a frame, as a share of the '
              'target size.', 0.0, 2.0),
    Parameter('size_noise', 0.015, 'Random relative change of the size a frame.', 0.0, 0.5),
])


class ColourParticleFilter(Tracker):
    """The colour particle filter (Condensation), the baseline of [Zhu2012, sec. 5]."""

    NAME = 'pf'
    SUMMARY = 'colour particle filter (Condensation)'
    PARAMETERS = _SHARED

    def _configure(self) -> None:
        self._histogram = ColourHistogram()

    def _start(self, frame: Frame, box: Box) -> Estimate:
        cx, cy = box.center
        self._mean = np.array([cx, cy, 0.0, 0.0, box.width, box.height])
        self._start_size = self._mean[4:].copy()
        self._reference = self._histogram.reference(frame, self._mean[[0, 1, 4, 5]])
        self._particles = np.repeat(self._mean[None], int(self._parameters['particles']), 0)
        self._history: deque[NDArray[np.float64]] = deque([self._mean], maxlen=20)
        return self._estimate(self._particles, np.full(len(self._particles), 1.0), 1.0)

    def _propose(self, dt: float) -> NDArray[np.float64]:
        n = int(self._parameters['particles'])
        previous = self._particles[self._rng.integers(0, len(self._particles), n)] if (
            len(self._particles) != n) else self._particles
        states = previous.copy()
        states[:, :2] += dt * states[:, 2:4]
        return self._diffuse(states, dt)

    def _diffuse(self, states: NDArray[np.float64], dt: float) -> NDArray[np.float64]:
        size = np.sqrt(np.prod(self._mean[4:]))
        noise = self._rng.standard_normal((len(states), 4)) * np.sqrt(dt)
        states[:, :2] += float(self._parameters['position_noise']) * size * noise[:, :2]
        states[:, 4:] *= np.exp(float(self._parameters['size_noise']) * noise[:, 2:])
        np.clip(states[:, 4:], 0.3 * self._start_size, 4 * self._start_size, out=states[:, 4:])
        return states

    def _update(self, frame: Frame, dt: float) -> Estimate:
        states = self._propose(dt)
        rho = self._histogram.coefficients(frame, states[:, [0, 1, 4, 5]], self._reference)
        sigma = float(self._parameters['sigma'])
        log_weights = -(1 - rho) / (2 * sigma**2)
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        previous = self._mean
        self._mean = weights @ states
        self._mean[2:4] = 0.5 * self._mean[2:4] + 0.5 * (self._mean[:2] - previous[:2]) / dt
        self._history.append(self._mean)
        estimate = self._estimate(states, weights, float(weights @ rho))
        ladder = (self._rng.random() + np.arange(len(states))) / len(states)
        picked = np.searchsorted(np.cumsum(weights), ladder).clip(max=len(states) - 1)
        self._particles = states[picked]
        self._particles[:, 2:4] = self._mean[2:4]
        return estimate

    def _estimate(self, states: NDArray[np.float64], weights: NDArray[np.float64],
                  confidence: float) -> Estimate:
        boxes = states[:, [0, 1, 4, 5]]
        mean = self._mean[[0, 1, 4, 5]]
        spread = boxes - mean
        covariance = (spread * (weights / weights.sum())[:, None]).T @ spread
        covariance += np.diag((0.02 * mean[[2, 3, 2, 3]])**2)
        return Estimate(
            box=Box.from_center(*mean), angle=0.0, covariance=covariance,
            confidence=confidence, particles=boxes,
            state=TrackState.TRACKING if confidence > 0.5 else TrackState.SEARCHING)


class GreyParticleFilter(ColourParticleFilter):
    """GMPF, the grey-prediction particle filter [Zhu2012]."""

    NAME = 'gmpf'
    SUMMARY = 'grey-prediction particle filter (GMPF)'
    PARAMETERS = _SHARED + ParameterTable([
        Parameter('window', 5, 'Length m of the series that the grey model is fitted to.', 4, 20,
                  unit='frames'),
    ])

    def _propose(self, dt: float) -> NDArray[np.float64]:
        window = int(self._parameters['window'])
        if len(self._history) < window:
            return super()._propose(dt)
        series = np.array(self._history)[-window:]
        slope = (series[-1] - series[0]) / (window - 1)
        forecast = series[-1] + slope * dt
        n = int(self._parameters['particles'])
        states = np.repeat(forecast[None], n, 0)
        return self._diffuse(states, dt)
