# Makes residual_diagnostics.json: R 4.2.2, packages base, stats, datasets only.
#   Rscript residual_diagnostics.R > residual_diagnostics.json
# shapiro.test, Box.test, rstudent, cooks.distance, hatvalues are R's; the others are written out here from their papers.

number <- function(x) paste(sprintf("%.17g", x), collapse = ", ")
field <- function(name, x) sprintf("  \"%s\": %s", name, if (length(x) == 1) number(x) else paste0("[", number(x), "]"))

anderson <- function(x) {
  n <- length(x)
  p <- pnorm(sort((x - mean(x)) / sd(x)))
  a <- -n - mean((2 * seq_len(n) - 1) * (log(p) + log(1 - rev(p))))
  a <- a * (1 + 0.75 / n + 2.25 / n^2)
  q <- if (a < 0.2) 1 - exp(-13.436 + 101.14 * a - 223.73 * a^2)
       else if (a < 0.34) 1 - exp(-8.318 + 42.796 * a - 59.938 * a^2)
       else if (a < 0.6) exp(0.9177 - 4.279 * a - 1.38 * a^2)
       else exp(1.2937 - 5.709 * a + 0.0186 * a^2)
  c(a, q)
}
moment <- function(x, k) mean((x - mean(x))^k)
# D'Agostino (1970): Johnson's S_U with matched kurtosis, written with ln(y + sqrt(y^2 + 1)).
skewness <- function(x) {
  n <- length(x)
  y <- moment(x, 3) / moment(x, 2)^1.5 * sqrt((n + 1) * (n + 3) / 6 / (n - 2))
  b <- 3 * (n^2 + 27 * n - 70) * (n + 1) * (n + 3) / (n - 2) / (n + 5) / (n + 7) / (n + 9)
  w <- sqrt(-1 + sqrt(2 * (b - 1)))
  a <- sqrt(2 / (w^2 - 1))
  z <- log(y / a + sqrt((y / a)^2 + 1)) / sqrt(log(w))
  c(z, 2 * pnorm(-abs(z)))
}
# Anscombe and Glynn (1983).
kurtosis <- function(x) {
  n <- length(x)
  b <- moment(x, 4) / moment(x, 2)^2
  v <- 24 * n * (n - 2) * (n - 3) / ((n + 1)^2 * (n + 3) * (n + 5))
  s <- (b - 3 * (n - 1) / (n + 1)) / sqrt(v)
  g <- 6 * (n^2 - 5 * n + 2) / ((n + 7) * (n + 9)) * sqrt(6 * (n + 3) * (n + 5) / (n * (n - 2) * (n - 3)))
  a <- 6 + (8 / g) * (2 / g + sqrt(1 + 4 / g^2))
  z <- (1 - 2 / (9 * a) - ((1 - 2 / a) / (1 + s * sqrt(2 / (a - 4))))^(1 / 3)) / sqrt(2 / (9 * a))
  c(z, 2 * pnorm(-abs(z)))
}
# Mean and variance of the number of runs from the distribution of the number itself, not from their formulas.
runs <- function(x) {
  a <- sum(x > 0); b <- sum(x < 0)
  r <- 2:(a + b)
  p <- sapply(r, function(k) {
    h <- k %/% 2
    if (k %% 2 == 0) 2 * choose(a - 1, h - 1) * choose(b - 1, h - 1)
    else choose(a - 1, h - 1) * choose(b - 1, h) + choose(a - 1, h) * choose(b - 1, h - 1)
  }) / choose(a + b, a)
  m <- sum(r * p)
  z <- (sum(diff(x > 0) != 0) + 1 - m) / sqrt(sum((r - m)^2 * p))
  c(z, 2 * pnorm(-abs(z)))
}
test <- function(result) c(unname(result$statistic), result$p.value)

fits <- list(
  # Brownlee's plant for the oxidation of ammonia: n = 21, q = 4, record 21 is the known outlier.
  stackloss = lm(stack.loss ~ Air.Flow + Water.Temp + Acid.Conc., stackloss),
  # Level of Lake Huron 1875-1972: n = 98, strongly correlated about its trend.
  lake_huron = lm(level ~ year, data.frame(level = as.numeric(LakeHuron), year = 1:98)),
  # Waiting times of the Old Faithful geyser: n = 272, two clusters, far from normal.
  faithful = lm(waiting ~ 1, faithful))
entries <- sapply(names(fits), function(name) {
  fit <- fits[[name]]
  e <- unname(residuals(fit))
  paste0(" \"", name, "\": {\n", paste(c(
    field("residual", e), field("leverage", unname(hatvalues(fit))), field("rstudent", unname(rstudent(fit))),
    field("cook", unname(cooks.distance(fit))), field("anderson_darling", anderson(e)),
    field("shapiro_wilk", test(shapiro.test(e))), field("skewness", skewness(e)), field("kurtosis", kurtosis(e)),
    field("ljung_box_5", test(Box.test(e, 5, "Ljung-Box"))), field("runs", runs(e))), collapse = ",\n"), "\n }")
})
small <- sapply(3:12, function(n) {
  x <- (1:n)^2
  sprintf("  [%d, %s]", n, number(test(shapiro.test(x))))
})
cat("{\n", paste(entries, collapse = ",\n"), ",\n \"shapiro_wilk_of_squares\": [\n", paste(small, collapse = ",\n"),
    "\n ]\n}\n", sep = "")
