"""A scene run many times: every combination of settings as a task of its own, in this process or on Dask's workers.

- `plan`: from a grid of settings to runs, checked before anything is simulated;
- `digest`: of any value, also of code, the same in every process;
- `description`: by which a run is known again, from its scene and metrics;
- `task`: one run to a row of figures, wherever it is done;
- `engine`: where runs are done;
- `store`: a folder that keeps rows, so that a sweep goes on where it ended;
- `page`: the rows as one HTML page;
- `sweep`: all of it together.
"""
