#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "apps/job/model_job.hpp"
#include "apps/stored_run/stored_run.hpp"
#include "identification/prediction/parameter_posterior.hpp"

namespace orbid::apps {

/// An estimated parameter of a stored run.
struct StoredEstimate {
    std::string model_name;  ///< as the model calls it
    std::string name;        ///< as the estimate does: k@run1
    std::size_t row = 0;     ///< in the stored covariance
    double value = 0.0;
    bool held = false;  ///< at its start value: no record determines it
};

/// The estimates of parameters of the model.
/// @param parameters  of the run's model, by name
/// @param experiment  whose values hold of parameters that are estimated per experiment; empty: none
/// @throws StoredRunRefused where there are none, or an experiment must be named.
[[nodiscard]] std::vector<StoredEstimate> stored_estimates(const StoredRun& run, const StoredRun::Json& parameters,
                                                           const std::string& experiment);

/// What a run knows of these parameters: scales and bounds, covariance, and draws where the run made some.
/// @param draws  false: the delta method is asked for, which needs the covariance
/// @throws StoredRunRefused where neither covariance nor draws are known.
[[nodiscard]] identification::ParameterPosterior stored_posterior(const StoredRun& run, const ModelJob& model,
                                                                  const std::vector<StoredEstimate>& estimates,
                                                                  bool draws);

namespace detail {

/// A number, or that of "value" in an object; nan where there is none.
[[nodiscard]] double stored_value(const StoredRun::Json& entry);

}  // namespace detail

}  // namespace orbid::apps
