from typing import Optional

__version__: str

class DataError(ValueError): ...

class System:
    @property
    def name(self) -> str: ...

def model(name: str, *, variant: str = "", size: Optional[int] = None) -> System: ...
