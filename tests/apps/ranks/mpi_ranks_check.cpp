// Run by mpi_ranks.py, under mpiexec or as if it were.
//   mpi_ranks_check exchange | exception | death
#include <csignal>
#include <exception>
#include <iostream>
#include <stdexcept>
#include <string>
#include <thread>

#include "apps/ranks/rank_plugin.hpp"
#include "tests/apps/ranks/rank_exchange.hpp"

using orbid::estimator::Ranks;

namespace {

int exchanged(Ranks& ranks) {
    if (ranks.rank() != 0) {
        // As a batch system does before it ends a job: rank 0 decides what happens.
        std::raise(SIGINT);
        std::raise(SIGTERM);
        return rank_exchange::follow(ranks);
    }
    rank_exchange::lead(ranks);
    std::cout << ranks.count() << " ranks have exchanged messages" << std::endl;
    return 0;
}

/// The last rank fails or dies while all others wait.
int one_fails(Ranks& ranks, const std::string& how) {
    if (ranks.rank() == ranks.count() - 1) {
        if (how == "exception") throw std::runtime_error("the last rank fails");
        std::raise(SIGKILL);
    }
    for (;;)
        (void)ranks.receive(Ranks::any);
}

}  // namespace

int main(int, char** arguments) {
    try {
        if (!orbid::apps::under_mpi()) {
            std::cout << "not under MPI" << std::endl;
            return 0;
        }
        const auto ranks = orbid::apps::mpi_ranks();
        const std::string what = arguments[1];
        return what == "exchange" ? exchanged(*ranks) : one_fails(*ranks, what);
    } catch (const std::exception& error) {
        std::cerr << "error: " << error.what() << std::endl;
        return 3;
    }
}
