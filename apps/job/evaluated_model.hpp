#pragma once

#include <memory>
#include <string>

#include "apps/job/job.hpp"

namespace orbid::apps {

/// The system of a model written in a job, as far as reading a job needs it: interpreted; where that cannot be done,
/// compiled.
///
/// @param compiled  set when it is compiled
/// @return nothing where neither is possible; `why` then says so.
[[nodiscard]] std::shared_ptr<const models::System> system_of(const std::shared_ptr<const models::Equations>& equations,
                                                              bool& compiled, std::string& why);

/// Seconds that flows of the job would take interpreted, to an order of magnitude, from the job alone: the decision to
/// compile must not depend on the machine, its load, or what its cache holds.
[[nodiscard]] double interpreted_seconds(const Job& job);

/// Compiles the equations of a job, or leaves them interpreted: as "compile" says; "auto" compiles where
/// interpreted_seconds() exceeds what a compilation takes. Where nothing can be compiled they are interpreted.
///
/// @return what was done and why, for the log; empty for a model of the registry.
[[nodiscard]] std::string settle_evaluation(Job& job);

/// What settle_evaluation() would do, for `orbid check`; nothing is compiled.
[[nodiscard]] std::string planned_evaluation(const Job& job);

}  // namespace orbid::apps
