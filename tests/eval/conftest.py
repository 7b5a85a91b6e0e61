import sys
from pathlib import Path

# Spawned workers inherit sys.path and import the toy environment by name, as gym.make("MODULE:ID") does.
sys.path.insert(0, str(Path(__file__).parent))
