"""An FMU for co-simulation, by FMPy, with variables by name."""

from __future__ import annotations

from ctypes import byref
from pathlib import Path

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.logging import addLoggerProxy


class Slave:
    """An instance of the FMU at ``path``, unpacked into ``folder``, that waits for its start values."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.folder = Path(fmpy.extract(str(path), str(folder)))
        description = fmpy.read_model_description(str(self.folder))
        self.known = {variable.name: variable for variable in description.modelVariables}
        self.said: list[str] = []
        self.time = 0.0
        self._fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=str(self.folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="slave",
        )
        callbacks = fmpy.fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(lambda *words: self.said.append(words[-1].decode()))
        callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        addLoggerProxy(byref(callbacks))
        self._callbacks = callbacks
        self._fmu.instantiate(callbacks=callbacks, loggingOn=True)
        self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()

    def __setitem__(self, name: str, value: float) -> None:
        variable = self.known[name]
        write = self._fmu.setInteger if variable.type == "Integer" else self._fmu.setReal
        write([variable.valueReference], [int(value) if variable.type == "Integer" else float(value)])

    def __getitem__(self, name: str) -> float:
        return self.all([name])[0]

    def all(self, names: list[str]) -> list[float]:
        """The values of several variables."""
        return [
            (self._fmu.getInteger if self.known[name].type == "Integer" else self._fmu.getReal)(
                [self.known[name].valueReference]
            )[0]
            for name in names
        ]

    def start(self) -> None:
        """End the initialization."""
        self._fmu.exitInitializationMode()

    def step(self, length: float = 1e-3) -> None:
        """One step."""
        self._fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=length)
        self.time += length

    def end(self) -> None:
        """End the simulation."""
        self._fmu.terminate()
        self._fmu.freeInstance()
