#pragma once

#include <string>

#include "apps/stored_run/forecast.hpp"

namespace orbid::apps {

/// Content of prediction.json, format orbid-prediction/1: per segment of a sampled record `course` (initial state
/// fitted to the whole segment) and `ahead` (fitted to its beginning: `rms` per coordinate, `normalised_rms`,
/// `horizon`, `whole`, `growth_rate`, `coverage`); of sections `steps` (one step ahead). Undefined numbers are null.
[[nodiscard]] std::string prediction_text(const Forecast& forecast);

/// Tables for standard output, with remarks in complete sentences.
/// @param heading  what was predicted, and by which run.
[[nodiscard]] std::string prediction_summary(const Forecast& forecast, const std::string& heading);

/// What an rms of errors over their sd means for a prediction; empty if near 1.
[[nodiscard]] std::string judgement(double normalised_rms);

}  // namespace orbid::apps
