"""The lights of a running study: one in memory at a time, each identified by the key of the data that was read."""

import torch

from glossbench.digests import compute_digest
from glossbench.envmap.cubemap import CubeMap
from glossbench.envmap.lights.light import Light
from glossbench.errors import InputError, MethodError
from glossbench.options import copy_of
from glossbench.process.state import is_foreign
from glossbench.run.attempts import Attempt
from glossbench.run.cell_files import make_key
from glossbench.run.store import Store
from glossbench.shading.outputs import check_key, check_notes
from glossbench.study.cells import to_text


class ChangedInput(InputError):
    """The file of an input has changed since the run began."""


class StudyLights:
    """The study's lights, one in memory at a time.

    Args:
        device: device of the lights.
        store: where a mark is kept while the light of a plug-in is made.
    """

    def __init__(self, device: str, store: Store) -> None:
        self._device, self._store = device, store
        self._item = ""  # text of the light in memory
        self._light: CubeMap | None = None
        # All by the text of the light (to_text).
        self._keys: dict[str, str] = {}
        self._notes: dict[str, tuple[str, ...]] = {}
        self._broken: dict[str, str] = {}
        self._digest = 0

    def get(self, item: Light) -> CubeMap:
        """The radiance of a light.

        Raises:
            ChangedInput: its file has changed since it was first read.
            MethodError: a plug-in's light is not a valid light, or it failed before.
        """
        if self._light is None or self._item != to_text(item):
            self._light = None
            light = self._make_of_plugin(item) if is_foreign(type(item)) else self._make(item)
            if self._keys.setdefault(to_text(item), light.key) != light.key:
                called = getattr(item, "file", item.name)
                raise ChangedInput(f"light {called}: has changed while the study ran; run it again")
            self._light, self._item, self._digest = light, to_text(item), compute_digest(light)
        return self._light

    def key(self, item: Light) -> str:
        """The key of the light. Only the light of a plug-in must be made for this; raises as `get` does."""
        text = to_text(item)
        if text not in self._keys:
            self._keys[text] = self.get(item).key if is_foreign(type(item)) else item.key()
        return self._keys[text]

    def learn(self, item: Light, key: str) -> None:
        """Take a key that another process has found, if it is not empty: the light that is made here must have it."""
        if key:
            self._keys.setdefault(to_text(item), key)

    def known_key(self, item: Light) -> str:
        """The key if it is known; "" if the light cannot be made."""
        return self._keys.get(to_text(item), "")

    def notes(self, item: Light) -> tuple[str, ...]:
        """What was changed or assumed when the light was made."""
        return self._notes[to_text(item)]

    def is_intact(self) -> bool:
        """Whether the light is unchanged since it was made: a write through shared memory would not be noticed."""
        return self._light is None or compute_digest(self._light) == self._digest

    def forget(self) -> None:
        """Drop the light, so that it is made again when it is needed."""
        self._light = None

    def _make(self, item: Light) -> CubeMap:
        made = copy_of(item)  # a copy, because it keeps what it decodes from a file
        light = made.cubemap()
        if not isinstance(light, CubeMap) or light.faces.dtype != torch.float32:
            raise MethodError(f"light {item.name}: cubemap must return a CubeMap of float32, got {light!r:.60}")
        check_key(item.name, light.key)
        self._notes[to_text(item)] = tuple(check_notes(item.name, made.notes()))
        return light.to(self._device)

    def _make_of_plugin(self, item: Light) -> CubeMap:
        """As `_make`, but a light that fails is not tried again, and one that ends the process at most twice."""
        text = to_text(item)
        if text in self._broken:
            raise MethodError(self._broken[text])
        attempt = Attempt(self._store, make_key(["light", item.name, item.as_dict()]))
        if attempt.is_hopeless:
            raise MethodError(f"light {item.name} ended the process {attempt.ended} times; it is skipped")
        attempt.begin()
        try:
            light = self._make(item)
        except BaseException as error:
            if not isinstance(error, KeyboardInterrupt):
                self._broken[text] = f"light {item.name}: {type(error).__name__}: {error}"
            attempt.end()
            raise
        attempt.end()
        return light
