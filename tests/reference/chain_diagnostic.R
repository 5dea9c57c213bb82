# Chains and their diagnostics, from the R package posterior. Run: Rscript chain_diagnostic.R > chain_diagnostic.csv
# Each line: case, item, numbers; the chains come first, one line each.
suppressPackageStartupMessages(library(posterior))
set.seed(20211)
chains <- function(n, m, make) sapply(seq_len(m), function(c) make(n, c))
ar1 <- function(n, rho) as.numeric(stats::filter(rnorm(n), rho, method = "recursive"))
cases <- list(
  independent = chains(100, 4, function(n, c) rnorm(n)),
  autocorrelated = chains(150, 4, function(n, c) ar1(n, 0.8)),
  antithetic = chains(80, 2, function(n, c) ar1(n, -0.6)),
  cauchy = chains(100, 4, function(n, c) rcauchy(n)),
  shifted = chains(60, 4, function(n, c) rnorm(n) + 0.7 * (c == 3)),
  wider = chains(60, 4, function(n, c) rnorm(n) * ifelse(c == 2, 3, 1)),
  drifting = chains(75, 3, function(n, c) rnorm(n) + 2 * seq_len(n) / n),
  tied = chains(61, 2, function(n, c) round(ar1(n, 0.5))),
  single = chains(90, 1, function(n, c) ar1(n, 0.4)),
  short = chains(14, 4, function(n, c) rexp(n)))
show <- function(case, item, x, digits) cat(case, item, vapply(x, format, "", digits = digits), sep = ",")
line <- function(case, item, x, digits = 17) { show(case, item, x, digits); cat("\n") }
cat("# posterior", as.character(packageVersion("posterior")), "R", paste(R.version$major, R.version$minor, sep = "."), "\n")
for (case in names(cases)) {
  x <- signif(cases[[case]], 8)   # stored exactly in few digits
  for (c in seq_len(ncol(x))) line(case, "chain", x[, c], 8)
  line(case, "rhat", rhat(x))
  line(case, "ess_bulk", ess_bulk(x))
  line(case, "ess_tail", ess_tail(x))
  line(case, "ess_mean", ess_mean(x))
  line(case, "mcse_mean", mcse_mean(x))
  line(case, "mcse_sd", mcse_sd(x))
  line(case, "quantiles", unname(quantile(x, c(0.025, 0.25, 0.5, 0.75, 0.975))))
  line(case, "ess_quantiles", ess_quantile(x, c(0.025, 0.25, 0.5, 0.75, 0.975), names = FALSE))
  line(case, "mcse_quantiles", mcse_quantile(x, c(0.025, 0.25, 0.5, 0.75, 0.975), names = FALSE))
}
