#pragma once

#include <cstddef>

#include <Eigen/Core>

#include "apps/stages/data_stage.hpp"
#include "apps/stored_run/prediction_job.hpp"
#include "orbits/series_residuals/series_residual.hpp"

namespace orbid::apps {

/// Scales of the errors and their relative parts, as the residual's groups have them.
struct ErrorScales {
    Eigen::VectorXd value;
    Eigen::VectorXd relative;
};

[[nodiscard]] ErrorScales scales_of(const orbits::SeriesResidual& residual);

/// The state in which a segment begins, fitted to its first samples.
struct SegmentBeginning {
    bool ok = false;
    Eigen::Index samples = 0;
    Eigen::VectorXd state;
    Eigen::VectorXd rms;  ///< per observed coordinate
};

/// Fits it to a stretch that doubles from 20 samples on, to at most a tenth of the segment, while the fit stays good.
[[nodiscard]] SegmentBeginning fitted_beginning(const PredictionJob& job, const Experiment& record,
                                                std::size_t segment);

}  // namespace orbid::apps
