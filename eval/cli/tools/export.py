"""`push-recovery export`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from ....controllers.errors import InvalidValueError
from ..options import EnvOptions


@dataclass(frozen=True, kw_only=True)
class Export(EnvOptions):
    """Write a learned policy in the format of others."""

    policy: Annotated[Positional[str], arg(metavar="POLICY")]
    """Learned policy by name (see list) or file."""
    onnx: Annotated[str, arg(metavar="FILE")]
    """ONNX file to write. It holds normalisation and network as float32; its metadata say what a residual's
    output means (docs/policies.md)."""

    def run(self) -> None:
        """Write the file, and say how well it agrees.

        Raises:
            MissingExtraError: onnx is not installed.
            PushRecoveryError: no learned policy, one made for another environment, or a file that does not
                compute the same, which is not written.
        """
        from ....controllers.learned.network import NetworkPolicy
        from ...export.graph import require_onnx
        from ...export.write import export_onnx
        from ...rollout.environments import make_env_for
        from ...rollout.policy_source import policy_sources

        require_onnx()
        source = policy_sources(self.policy)[self.policy]
        env = make_env_for(source.origin, self.env_id)
        try:
            policy = source.load(env)
            if not isinstance(policy, NetworkPolicy):
                raise InvalidValueError(f"policy {self.policy!r} has no network: name a learned one")
            difference = export_onnx(policy, env, Path(self.onnx))
        finally:
            env.close()
        print(f"{self.onnx}: agrees with numpy to {difference:.1e} in the action")
