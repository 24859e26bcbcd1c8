"""The paper's study from end to end, and its page.

- `study`: the study in the paper's order.
- `estimates`: coefficients and intervals of every method in one form.
- `scores`: errors, coverages and their standard errors.
- `denoisers`: methods of denoising, and draws of the denoised record carried into the regression.
- `measurements`: discretisation, methods, published errors.
- `prior_ships`: ships drawn from the study's priors.
- `findings`: results of the study, in sentences.
- `bound_chapter`: all methods compared with the Cramer-Rao bound.
- `tables`: tables of the page and as CSV.
- `figures`: figures of the study.
- `page`: the page of the study.
"""
