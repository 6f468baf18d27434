//! Event cameras: Prophesee EVK4 and iniVation DAVIS346.
