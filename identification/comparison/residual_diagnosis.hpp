#pragma once

#include <string>
#include <vector>

#include "estimator/estimate/estimate.hpp"
#include "estimator/interface/residual.hpp"
#include "estimator/uncertainty/residual_diagnostic.hpp"

namespace orbid::identification {

/// A conspicuous record, by its place.
struct OutlierRecord {
    std::string block;    ///< as the residual labels it
    Eigen::Index record;  ///< of the group within the block, from 0
    double studentised;
    double p;
};

/// What the residuals of one group show about its errors.
struct GroupDiagnostic {
    std::string group;
    estimator::ResidualDiagnostic diagnostic;
    std::vector<OutlierRecord> outliers;
};

/// Residuals of every group whose distribution can be examined.
[[nodiscard]] std::vector<GroupDiagnostic> diagnose_residuals(const std::vector<const estimator::Residual*>& residuals,
                                                              const estimator::Estimate& estimate);

}  // namespace orbid::identification
