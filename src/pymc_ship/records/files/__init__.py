"""Files of trials as a logger wrote them, and what sensors add to a clean record.

- `reading`: a trial file as the record of a trial.
- `format`: columns, units, signs and frame of a file, as TOML.
- `columns`: headings of columns, their channels and units.
- `clock`: stamps of any usual clock as seconds.
- `interpolation`: channels of different sensors on one time base.
- `time_base`: uniform time from the stamps of a logger.
- `tables`: Parquet, xlsx, NetCDF and MAT files and bags of ROS as tables.
- `text_rows`: lines of a text file, and logs of NMEA 0183, as tables.
- `ship_scale`: length and speed of the ship in a record, block means, least squares.
- `sides`: letters of sides beside numbers, the side of a positive rudder, and the axes of a file.
- `noise`: noise of given kinds added to a clean record.
- `instruments`: sensors with resolution, gaps and jitter.
"""
