"""Examples of each command, at the end of its help."""

EXAMPLES = {
    "simulate": """examples:
  pymc-ship simulate container --zigzag 20/20 --noise 0.01 --out trial.csv
  pymc-ship simulate container --turn 35 --noise gnss,mems_gyro,mru,fluxgate_compass --out circle.csv

Python: `ps.simulate`.
""",
    "denoise": """examples:
  pymc-ship denoise trial.csv --out smooth.csv
  pymc-ship denoise trial.csv --method rts --out smooth.csv

Python: `ps.denoise`.
""",
    "check": """examples:
  pymc-ship check trial.csv --vessel container
  pymc-ship check trial.txt --format columns.toml --vessel my.toml --out corrected.csv

exit status 3: a check is bad; no corrected trial is written.
exit status 4: the record is corrected, cut or doubtful.
Python: `ps.trial_checks`.
""",
    "regress": """examples:
  pymc-ship regress trial.csv --vessel container --out regressed
  pymc-ship regress smooth.csv --vessel my.toml --raw --select bayesian_optimisation --out regressed

Python: `ps.identify`.
""",
    "identify": """examples:
  pymc-ship identify trials/*.csv --vessel my_ship.toml --out reports/my_ship
  pymc-ship identify zigzag.csv circle.csv --vessel kvlcc2 --format columns.toml --out reports/tanker

exit status 3: a check of a trial is bad; `pymc-ship check` names the remedy.
Python: `ps.identify_ship`.
""",
    "fit": """examples:
  pymc-ship fit trial.csv --vessel container --out fitted
  pymc-ship fit zigzag.csv circle.csv --vessel my.toml --prior sister_ship --channels u,v,r,psi --out fitted

Python: `ps.trajectory_posterior`.
""",
    "tune": """example:
  pymc-ship tune trial.csv --vessel container --dof yaw --family semiconjugate --evaluations 60 --out prior.json

Python: `ps.identify(..., selection="bayesian_optimisation")`.
""",
    "forecast": """examples:
  pymc-ship forecast reports/my_ship --zigzag 10/10 --turn 35
  pymc-ship forecast reports/my_ship --measured circle.csv --format columns.toml
  pymc-ship forecast regressed --vessel container --zigzag 10/10 --turn 35 --out forecast
  pymc-ship forecast trajectory.nc --vessel my.toml --zigzag 20/20 --draws 1000 --out forecast

Python: `ps.forecast`.
""",
    "design": """examples:
  pymc-ship design reports/my_ship --sea-room 3000 --wind 8/270 --out design
  pymc-ship design trajectory.nc --vessel container --n 2 --out design

Python: `ps.design`.
""",
    "montecarlo": """examples:
  pymc-ship montecarlo studies/container.toml --out reports/montecarlo
  pymc-ship montecarlo my.toml --scheduler tcp://10.0.0.1:8786 --out grid

Python: `ps.montecarlo`.
""",
    "study": """example:
  pymc-ship study --vessel container --level 0.01 --seed 2020 --out reports/study

exit status 3: a convergence diagnostic or the agreement of the methods fails.
Python: `ps.study`.
""",
    "report": """examples:
  pymc-ship report regressed/sway-conjugate.nc --vessel container --out diagnostics
  pymc-ship report reports/study/posteriors/sway-*-nuts.nc

draws are compared with an exact posterior of the same data and prior, if one is given.
exit status 3: a convergence diagnostic or the agreement fails.
Python: `ps.diagnostic_report`.
""",
    "score": """examples:
  pymc-ship score reports/my_ship circle.csv zigzag.csv --format columns.toml
  pymc-ship score my_ship.toml trials/*.csv --length 100 --every 20 --out scored

Python: `ps.score`.
""",
    "trial-report": """examples:
  pymc-ship trial-report circle.csv zigzag.csv --vessel my_ship.toml --conditions day.toml --out reports/trial
  pymc-ship trial-report runs/*.csv --vessel ballast.toml --ship reports/my_ship --full-load full.toml --out trial

Python: `ps.trial_report`.
""",
}
