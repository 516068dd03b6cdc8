# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a recording's metadata say of its estimators: model, configuration and runtime.

The first two are in estimator_health, the runtime is in /diagnostics, beside the hash of the
configuration that it belongs to.
"""

from terrain_estimator.messaging.diagnostics import RUNTIME
from terrain_estimator.topics import Message

IDENTITY_BYTES = 1 << 16
"""[B] Largest sum of the identities in a bag: some 200 of the usual length."""
MOST_RUNTIMES = 64
"""[1] Configurations whose runtime is remembered: the last ones."""
_FIELDS = ("model_id", "model_sha256", "configuration_sha256")
_OF_RUNTIME = ("runtime", "runtime_reason")


class TooLongError(ValueError):
    """The identities of a recording are longer than its metadata may be."""


class Identities:
    """The identities of the estimators in one bag, each told once."""

    def __init__(self) -> None:
        """Start without any."""
        self._told: set[tuple[str, ...]] = set()
        self._bytes = 0
        self._runtimes: dict[str, tuple[str, ...]] = {}  # by the hash of the configuration

    def hear(self, diagnostics: Message) -> None:
        """Remember the runtimes in a message of /diagnostics."""
        for status in diagnostics.status:
            values = {each.key: each.value for each in status.values}
            if status.name.endswith(f": {RUNTIME.name}") and "runtime" in values:
                runtime = tuple(values.get(name, "") for name in _OF_RUNTIME)
                configuration = values.get("configuration_sha256", "")
                if sum(map(len, (configuration, *runtime))) <= IDENTITY_BYTES:
                    self._runtimes.pop(configuration, None)
                    self._runtimes[configuration] = runtime
        for oldest in list(self._runtimes)[:-MOST_RUNTIMES]:
            del self._runtimes[oldest]

    def new(self, topic: str, health: Message) -> dict[str, str] | None:
        """Return the identity in a message of health of ``topic``; None where it was told before.

        Until /diagnostics has told it, the runtime is empty; then the identity is told again.

        Raises:
            TooLongError: it would make the identities longer than IDENTITY_BYTES.
        """
        runtime = self._runtimes.get(health.configuration_sha256, ("",) * len(_OF_RUNTIME))
        identity = (topic, *(getattr(health, name) for name in _FIELDS), *runtime)
        if identity in self._told:
            return None
        size = sum(len(text.encode()) for text in identity)
        if self._bytes + size > IDENTITY_BYTES:
            raise TooLongError(
                f"{topic}: the ids of its models and configurations are longer than"
                f" {IDENTITY_BYTES} bytes, so that the bag's metadata lack the newest: check its"
                " publishers"
            )
        self._told.add(identity)
        self._bytes += size
        return dict(zip(("topic", *_FIELDS, *_OF_RUNTIME), identity, strict=True))
