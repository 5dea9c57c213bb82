#include "apps/campaign/engine/crew.hpp"

#include <thread>
#include <vector>

#include "apps/campaign/engine/worker.hpp"
#include "apps/ranks/process_ranks.hpp"
#include "estimator/ranks/thread_ranks.hpp"

namespace orbid::apps {

namespace {

class ThreadCrew final : public Crew {
public:
    ThreadCrew(int computing, const TaskRunner& runner) : all_(computing + 1) {
        for (int rank = 1; rank <= computing; ++rank)
            threads_.emplace_back([this, rank, &runner] {
                (void)serve_tasks(all_[rank], runner);
                all_.end(rank);
            });
    }
    ~ThreadCrew() override {
        all_.end(0);
        for (std::thread& thread : threads_)
            thread.join();
    }
    [[nodiscard]] estimator::Ranks& ranks() override { return all_[0]; }
    [[nodiscard]] std::string how_ended(int) override { return "its thread has ended"; }
    bool restart(int) override { return false; }
    bool kill(int) override { return false; }

private:
    estimator::ThreadRanks all_;
    std::vector<std::thread> threads_;
};

class ProcessCrew final : public Crew {
public:
    ProcessCrew(int computing, const TaskRunner& runner)
        : all_(computing + 1, [&runner](estimator::Ranks& ranks) { return serve_tasks(ranks, runner); }) {}
    [[nodiscard]] estimator::Ranks& ranks() override { return all_; }
    [[nodiscard]] std::string how_ended(int rank) override { return all_.how_ended(rank); }
    bool restart(int rank) override {
        all_.restart(rank);
        return true;
    }
    bool kill(int rank) override {
        all_.kill(rank);
        return true;
    }

private:
    ProcessRanks all_;
};

class GivenCrew final : public Crew {
public:
    explicit GivenCrew(estimator::Ranks& ranks) : ranks_(ranks) {}
    [[nodiscard]] estimator::Ranks& ranks() override { return ranks_; }
    [[nodiscard]] std::string how_ended(int) override { return "its rank has ended"; }
    bool restart(int) override { return false; }
    bool kill(int) override { return false; }

private:
    estimator::Ranks& ranks_;
};

}  // namespace

std::unique_ptr<Crew> thread_crew(int computing, const TaskRunner& runner) {
    return std::make_unique<ThreadCrew>(computing, runner);
}

std::unique_ptr<Crew> process_crew(int computing, const TaskRunner& runner) {
    return std::make_unique<ProcessCrew>(computing, runner);
}

std::unique_ptr<Crew> given_crew(estimator::Ranks& ranks) {
    return std::make_unique<GivenCrew>(ranks);
}

}  // namespace orbid::apps
