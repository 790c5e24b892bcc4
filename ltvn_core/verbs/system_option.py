"""The option that names a navigation system. Owns nothing but its type, which lists the systems that are installed."""

from typing import TYPE_CHECKING, Literal, TypeAlias

from ltvn_core.systems.registry import system_names

if TYPE_CHECKING:
    SystemName: TypeAlias = str
else:
    SystemName = Literal[system_names()]
