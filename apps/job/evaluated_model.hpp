#pragma once

#include <memory>
#include <string>

#include "apps/job/job.hpp"

namespace orbid::apps {

/// The system of a model written in a job, as needed to read the job: interpreted or, where that is impossible,
/// compiled.
///
/// @param compiled  set when it is compiled
/// @return nothing where neither is possible; `why` then gives the reason.
[[nodiscard]] std::shared_ptr<const models::System> system_of(const std::shared_ptr<const models::Equations>& equations,
                                                              bool& compiled, std::string& why);

/// Compiles the equations of a job or leaves them interpreted, as "compile" says. "auto" compiles if
/// the flows would take longer interpreted than a compilation, judged from the job alone. Equations that cannot be
/// compiled are interpreted.
///
/// @return what was done and why, for the log; empty for a model of the registry.
[[nodiscard]] std::string settle_evaluation(Job& job);

/// Whether settle_evaluation() would compile: "compile" asks for it, it is possible, and the cache has no such model.
[[nodiscard]] bool is_compiled_first(const Job& job);

/// What settle_evaluation() would do, for `orbid check`; nothing is compiled.
[[nodiscard]] std::string planned_evaluation(const Job& job);

}  // namespace orbid::apps
