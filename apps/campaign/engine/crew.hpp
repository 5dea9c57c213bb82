#pragma once

#include <memory>
#include <string>

#include "apps/campaign/engine/task_run.hpp"
#include "estimator/ranks/ranks.hpp"

namespace orbid::apps {

/// The ranks of a campaign, seen from rank 0, and what can be done to one of them.
class Crew {
public:
    Crew() = default;
    Crew(const Crew&) = delete;
    Crew& operator=(const Crew&) = delete;
    virtual ~Crew() = default;

    [[nodiscard]] virtual estimator::Ranks& ranks() = 0;
    /// Why a rank that was lost has ended: "killed by SIGSEGV".
    [[nodiscard]] virtual std::string how_ended(int rank) = 0;
    /// Puts another one in the place of a rank that was lost. False: that cannot be done.
    virtual bool restart(int rank) = 0;
    /// Ends a rank at once; it is lost then. False: that cannot be done.
    virtual bool kill(int rank) = 0;
};

/// Threads of this process: nothing can be killed, and a crash ends all.
[[nodiscard]] std::unique_ptr<Crew> thread_crew(int computing, const TaskRunner& runner);

/// Processes of this machine, made without another program: this process has one thread when it is called.
[[nodiscard]] std::unique_ptr<Crew> process_crew(int computing, const TaskRunner& runner);

/// Ranks that were started together by another program (MPI): they serve already.
[[nodiscard]] std::unique_ptr<Crew> given_crew(estimator::Ranks& ranks);

}  // namespace orbid::apps
