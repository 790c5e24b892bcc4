"""When an edge can be driven, as a matter of time: filters over observations that something was there or was not."""
