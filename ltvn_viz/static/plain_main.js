// Begin on a page that drives nothing: viser's own, which needs to be let in alone.

keepScheme();
letViserIn();
