#pragma once

#include <limits>
#include <string>
#include <vector>

#include "apps/job/job.hpp"
#include "apps/program/check/data_check.hpp"

namespace orbid::apps {

/// Seconds of one core that following the model takes on this machine, from one point of an experiment to the next.
struct FlowRate {
    double value = std::numeric_limits<double>::quiet_NaN();        ///< states alone
    double derivatives = std::numeric_limits<double>::quiet_NaN();  ///< with those after state and free parameters
    std::string unknown;  ///< why there is none: "8 samples took longer than a second"; empty: known, or not asked for
};

/// Measured on processor time for a tenth of a second or so, one second at most: of a fitted series by evaluating its
/// first readings at the start of the estimate with all derivatives, of a simulation by a shorter one. Stiff or
/// interpreted equations, measured inputs and sensors cost what they cost there. Other experiments stay empty.
/// @param data  what the job's files hold
/// @return one for each experiment; `unknown` also where single shooting over a chaotic record is asked for
[[nodiscard]] std::vector<FlowRate> measured_rates(const Job& asked, const DataCheck& data);

}  // namespace orbid::apps
