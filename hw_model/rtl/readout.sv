// The readout: a tally for each compartment that is read out, and at the end the class whose weighted tallies add up to the most.
//
// A tally counts spikes or, with `by_potential`, holds the largest potential from a step on (0 where there is no such step, as
// all tallies begin with 0). A population that is read out has a compartment per class, and its tallies follow each other,
// population by population. The score of a class is the sum of weight * tally over the populations. A product is made bit by
// bit of the weight, one per cycle, from shifted tallies. The first of classes with equal scores wins.
module readout #(
    parameter integer ENTRIES = 128,  // compartments that are read out
    // 1: the sign of a weight, which comes late from its memory, is applied in the addition and not before it. This makes the
    // slowest path shorter and takes more logic.
    parameter integer FAST = 0
) (
    input  logic                       clk,
    input  logic                       clear,
    input  logic                       load_weight,
    input  logic [23:0]                load_address,
    input  logic [127:0]               load_data,
    input  logic [23:0]                classes,      // compartments of a population
    input  logic [23:0]                populations,  // that are read out
    input  logic                       from_here,    // this is the first step whose potentials count
    input  logic                       after_here,   // an earlier step was the first whose potentials count
    input  logic                       sweep,
    input  logic [$clog2(ENTRIES)-1:0] sweep_address,
    // A compartment that is read out: whether it has a tally, and which, two cycles before its results, so that the tally can
    // be read; then its results.
    input  logic                       early_read,
    input  logic [$clog2(ENTRIES)-1:0] early_entry,
    input  logic                       read_out,
    input  logic                       by_potential,
    input  logic [$clog2(ENTRIES)-1:0] entry,
    input  logic                       fired,
    input  logic signed [23:0]         potential,
    input  logic                       start,        // after the last phase: compute the scores
    output logic                       done,         // high for a cycle, when `winner` is known
    output logic [15:0]                winner,
    // For test benches: every score, once it is known.
    output logic                       score_valid,
    output logic signed [63:0]         score
);
    localparam integer ENTRY = $clog2(ENTRIES);
    localparam integer GROUPS = 64, GROUP = 6;  // populations that are read out, at most, and the bits of their number
    // At the end, for each class and in it for each population: READ a tally and its weight, LOAD them, MULTIPLY, and add
    // to the score. Then COMPARE the score with the best one, and DECIDE which is the best so far.
    localparam logic [2:0] IDLE = 0, READ = 1, LOAD = 2, MULTIPLY = 3, COMPARE = 4, DECIDE = 5;

    logic [2:0]         state;
    logic [ENTRY-1:0]   address;
    // A digit at the end of a name is the cycle of update.sv: a tally is asked for in cycle 6 of its compartment, shown by
    // the memory in cycle 7, and written in cycle 8.
    logic signed [23:0] stored, tally8, new_tally;
    logic               write;

    logic               early7;
    wire                ticking;  // while a tally is on its way, and at the end
    always_ff @(posedge clk) early7 <= early_read;
    clock_gate gate (
        .clk, .enable(clear || load_weight || early_read || early7 || read_out || start || done || state != IDLE), .gated(ticking)
    );

    memory #(.WIDTH(24), .DEPTH(ENTRIES)) tallies (
        .clk          (ticking),
        .write        (sweep || (read_out && write)),
        .write_address(sweep ? sweep_address : entry),
        .write_data   (sweep ? 24'b0 : new_tally),
        .read         (early_read || state != IDLE),
        .read_address (state == IDLE ? early_entry : address),
        .read_data    (stored)
    );
    always_ff @(posedge ticking) tally8 <= stored;

    always_comb begin
        write = fired;
        new_tally = tally8 + 24'd1;
        if (by_potential) begin
            write = from_here || (after_here && tally8 < potential);
            new_tally = potential;
        end
    end

    // Weights are a sign and a magnitude.
    logic [32:0]        weight;
    logic [GROUP:0]     population;
    memory #(.WIDTH(33), .DEPTH(GROUPS)) weights (
        .clk          (ticking),
        .write        (load_weight),
        .write_address(load_address[GROUP-1:0]),
        .write_data   (load_data[32:0]),
        .read         (state == READ),
        .read_address (population[GROUP-1:0]),
        .read_data    (weight)
    );
    logic [ENTRY:0]     class_number;
    logic [31:0]        factor;    // bits of the weight's magnitude that are left, the next at bit 0
    logic               negative;  // the weight is
    // A product of a negative weight is subtracted. -x is ~x + 1, so the inverted bits of `addend` are added, and 1 with them,
    // as the carry that `{score, 1'b1}` and `negative` below the lowest bit make.
    logic [63:0]        addend;
    logic signed [63:0] best;
    logic               better;
    wire [64:0]         sum = {score, 1'b1} + {FAST != 0 ? addend ^ {64{negative}} : addend, negative};

    assign score_valid = state == COMPARE;
    always_ff @(posedge ticking) begin
        done <= 0;
        case (state)
            IDLE: if (start) begin
                {class_number, population, address} <= 0;
                winner <= 0;
                score <= 0;
                if (classes == 0) done <= 1;
                else state <= READ;
            end
            READ: state <= LOAD;
            LOAD: begin
                addend <= {{40{stored[23]}}, stored} ^ {64{FAST == 0 && weight[32]}};
                {negative, factor} <= weight;
                state <= MULTIPLY;
            end
            MULTIPLY:
            if (factor != 0) begin
                if (factor[0]) score <= sum[64:1];
                addend <= {addend[62:0], FAST == 0 && negative};
                factor <= factor >> 1;
            end else begin
                population <= population + 1;
                address <= address + classes[ENTRY-1:0];
                state <= population + 1 == populations[GROUP:0] ? COMPARE : READ;
            end
            COMPARE: begin
                better <= class_number == 0 || best < score;
                state <= DECIDE;
            end
            default: begin
                if (better) begin
                    best <= score;
                    winner <= 16'(class_number);
                end
                class_number <= class_number + 1;
                population <= 0;
                address <= class_number[ENTRY-1:0] + 1'b1;
                score <= 0;
                if (class_number + 1 == classes[ENTRY:0]) begin
                    done <= 1;
                    state <= IDLE;
                end else state <= READ;
            end
        endcase
        if (clear) begin
            state <= IDLE;
            done <= 0;
        end
    end

    wire unused = &{1'b0, load_address, load_data, classes, populations, sum[0]};
endmodule
