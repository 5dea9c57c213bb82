#include <stdexcept>
#include <string>
#include <vector>

#include "tests/catch.hpp"
#include "tests/estimator/algebra/part_of_problem.hpp"
#include "tests/estimator/ranks/on_ranks.hpp"

namespace spread_refusal_test {

using namespace orbid::estimator;
using orbid::estimator::test::part_of;
using orbid::estimator::test::StackedProblem;
using orbid::tests::on_ranks;

TEST_CASE("Parts of a chain that do not fit together are refused", "[estimator][ranks]") {
    const StackedProblem problem = test::random_problem(8, 2, 1, test::Shape::chain, 1.0, 3);
    const auto message_of = [&](const auto& part) {
        try {
            on_ranks(2, [&](Ranks& ranks) {
                Collective all(ranks);
                Spread spread;
                spread.ranks = &all;
                std::vector<BlockTriangle> blocks = part(ranks.rank(), spread);
                static_cast<void>(factorise(std::move(blocks), 1, spread));
            });
        } catch (const std::exception& error) {
            return std::string(error.what());
        }
        return std::string();
    };
    const auto has = [](const std::string& text, const std::string& what) {
        CAPTURE(text);
        CHECK(text.find(what) != std::string::npos);
    };
    has(message_of([&](int rank, Spread& spread) {
            if (rank == 0) spread.after = 3;  // the last own block, with its rows
            if (rank == 1) spread.before = 0;
            std::vector<BlockTriangle> part = part_of(problem, rank == 0 ? 0 : 4, rank == 0 ? 4 : 8, false);
            if (rank == 0) part.back().next = -1, part.back().link.resize(0, 0);
            return part;
        }),
        "rows of its own");
    has(message_of([&](int rank, Spread& spread) {
            if (rank == 1) spread.before = 0;
            return part_of(problem, rank == 0 ? 0 : 4, rank == 0 ? 4 : 8, rank == 0);
        }),
        "do not fit together");
    has(message_of([&](int rank, Spread& spread) {
            (rank == 0 ? spread.after : spread.before) = rank == 0 ? 4 : 1;
            return part_of(problem, rank == 0 ? 0 : 4, rank == 0 ? 4 : 8, rank == 0);
        }),
        "must begin a chain");
}

}  // namespace spread_refusal_test
