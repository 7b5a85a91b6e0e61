"""Clone a policy from a data set, by TorchRL's replay buffer, and score the clone beside it.

pip install '.[data,train]' torchrl
push-recovery dataset --suite standard --policies two-stage
python examples/clone.py [push-recovery/biped/standard-two-stage-v0] [GRADIENT STEPS]
"""

import sys

import minari
import numpy as np
import torch
from tensordict import TensorDict
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer

from push_recovery import evaluate

dataset = sys.argv[1] if len(sys.argv) > 1 else "push-recovery/biped/standard-two-stage-v0"
steps = int(sys.argv[2]) if len(sys.argv) > 2 else 20_000
# Read by Minari: MinariExperienceReplay of TorchRL 0.14.1 gives arrays of zeros
episodes = list(minari.load_dataset(dataset))
seen = torch.as_tensor(np.concatenate([one.observations[:-1] for one in episodes])).float()
done = torch.as_tensor(np.concatenate([one.actions for one in episodes]))
data = TensorDictReplayBuffer(storage=LazyTensorStorage(len(seen)), batch_size=1024)
data.extend(TensorDict({"observation": seen, "action": done}, batch_size=[len(seen)]))
mean, deviation = seen.mean(0), seen.std(0) + 1e-3

hidden = torch.nn.Linear(36, 256), torch.nn.Tanh(), torch.nn.Linear(256, 256), torch.nn.Tanh()
net = torch.nn.Sequential(*hidden, torch.nn.Linear(256, 7))
optimiser = torch.optim.Adam(net.parameters(), 1e-3)
for step in range(steps):
    batch = data.sample()
    loss = (net((batch["observation"] - mean) / deviation) - batch["action"]).square().mean()
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
    if step % 1000 == 999:
        print(f"{step + 1} steps: mean square of the action's error {loss.item():.4f}")


class Clone:
    """The network as a policy."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        """Actions (n, 7), or one (7,), and the state that was handed in."""
        with torch.no_grad():
            action = net((torch.as_tensor(observation, dtype=torch.float32) - mean) / deviation)
        return np.clip(action.numpy(), -1.0, 1.0), state


found = evaluate({"clone": Clone(), "two-stage": "two-stage"}, "quick", workers=1)
for name in found.rows:
    score = found.score(name)
    print(f"{name}: {score.recovered} of {score.episodes} recovered, {score.survived} survived")
