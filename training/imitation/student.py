"""The learner: a tanh network on normalised joint observations, fitted to the targets that were shown."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from ...controllers.joints.observation import JOINT_OBSERVATION_SIZE, PREVIOUS_ACTION
from ...controllers.learned.mlp import Mlp, Normalisation
from ...controllers.whole_body.kinematics import NU
from .settings import ImitationSettings

Floats = NDArray[np.float32]

# The previous action is hidden: it tells what the teacher asks next so well that a learner copies it, and
# then goes on with its own errors.
HIDDEN = slice(PREVIOUS_ACTION, PREVIOUS_ACTION + NU)
HIDE = 1e12  # variance of an entry that the network is not to see
LEAST = 1e-4  # variance of an entry that hardly moves


class Student:
    """A network and the normalisation before it, as `NetworkPolicy` has them.

    Args:
        settings: of the run.
    """

    def __init__(self, settings: ImitationSettings):
        generator = torch.Generator().manual_seed(settings.seed)
        widths, layers = (JOINT_OBSERVATION_SIZE, *settings.layers, NU), []
        for inputs, outputs in pairwise(widths):
            layers += [_linear(inputs, outputs, generator), nn.Tanh()]
        self.network = nn.Sequential(*layers[:-1])
        self.beta = settings.beta
        self.mean: AveragedModel | None = None
        self.optimiser = torch.optim.Adam(self.network.parameters())
        self.normalisation = normalisation_of(np.zeros((1, JOINT_OBSERVATION_SIZE), np.float32))

    def see(self, observations: Floats) -> None:
        """Take mean and variance of these observations (n, 58)."""
        self.normalisation = normalisation_of(observations)

    def act(self, observations: NDArray[np.float64]) -> Floats:
        """Targets (n, 14) in action units, clipped to [-1, 1]."""
        with torch.no_grad():
            targets = self.network(torch.from_numpy(self.normalisation.apply(observations)))
        return np.clip(targets.numpy(), np.float32(-1.0), np.float32(1.0))

    def fit(self, observations: Floats, targets: Floats, rate: float) -> float:
        """One gradient step towards the targets (n, 14) of observations (n, 58); returns the loss."""
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        seen = torch.from_numpy(self.normalisation.apply(observations.astype(np.float64)))
        loss = nn.functional.smooth_l1_loss(self.network(seen), torch.from_numpy(targets), beta=self.beta)
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()
        if self.mean is not None:
            self.mean.update_parameters(self.network)
        return loss.item()

    def begin_mean(self, share: float) -> None:
        """Let the result be a running mean of the weights from here on, of which each step has a share."""
        self.mean = AveragedModel(self.network, multi_avg_fn=get_ema_multi_avg_fn(1.0 - share))

    def mlp(self) -> Mlp:
        """The network in numpy."""
        layers = [one for one in (self.mean or self.network).modules() if isinstance(one, nn.Linear)]
        weights, biases = (
            tuple(getattr(layer, name).detach().numpy().copy() for layer in layers)
            for name in ("weight", "bias")
        )
        return Mlp(weights, biases)


def normalisation_of(observations: Floats) -> Normalisation:
    """Mean and variance of observations (n, 58); the previous action is hidden."""
    mean = observations.mean(axis=0, dtype=np.float64)
    variance = observations.var(axis=0, dtype=np.float64) + LEAST
    mean[HIDDEN], variance[HIDDEN] = 0.0, HIDE
    return Normalisation(mean, variance)


def _linear(inputs: int, outputs: int, generator: torch.Generator) -> nn.Linear:
    """A layer whose weights are drawn as torch draws them, from a generator of its own."""
    layer, bound = nn.Linear(inputs, outputs), inputs**-0.5
    for parameter in layer.parameters():
        nn.init.uniform_(parameter, -bound, bound, generator=generator)
    return layer
